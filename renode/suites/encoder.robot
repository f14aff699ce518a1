*** Settings ***
Documentation     LS7266R1: the 24-bit counter wraps, the board's position does not; a counter that lost its registers.
Library           ForceBoard.py

*** Test Cases ***
Counter And Board Agree
    Armed Board
    Hold For    500
    FOR    ${unit}    IN RANGE    1    7
        Position Should Follow The Counter    ${unit}
    END

Position Goes On Over The Wrap
    Power Up Board
    Advance    300
    Connect
    Bring Up Units
    Stream    1
    Advance    100
    ${first}=    Encoder Position    1
    ${second}=    Encoder Position    2
    # 24 bits end 11,184,811 counts above where the counters begin, and 5,592,405 below. A step stays below the 100,000 counts within
    # 6 ms by which the board knows a counter that lost its registers.
    FOR    ${step}    IN RANGE    145
        Execute Command    rig TurnEncoder 1 80000
        Execute Command    rig TurnEncoder 2 -80000
        Advance    10
    END
    ${first_after}=    Encoder Position    1
    ${second_after}=    Encoder Position    2
    Should Be Equal As Integers    ${{$first_after - $first}}    11600000
    Should Be Equal As Integers    ${{$second_after - $second}}    -11600000
    ${first_counter}=    Number    counters Counter 1
    Should Be True    ${first_counter} < 1000000
    ${second_counter}=    Number    counters Counter 2
    Should Be True    ${second_counter} > 10000000
    Position Should Follow The Counter    1
    Position Should Follow The Counter    2

A Counter That Lost Its Registers Is A Fault
    Armed Board
    Output Should Drive
    # After a dip of its 5 V a counter stands elsewhere, most likely at 0.
    Execute Command    rig TurnEncoder 3 -5592405
    Hold For    20
    Board Fault Should Be    encoder counter fault
    ${status}=    Status
    # Bit 8: lost after the start; bits 7 to 0: the chip, from 1.
    Should Be Equal As Integers    ${status}[fault_detail]    0x102
    Output Should Be Zero
    # It is set up again, and begins anew.
    ${counter}=    Number    counters Counter 3
    Should Be True    abs(${counter} - 0x555555) < 1000
