*** Settings ***
Documentation     LS7266R1: the 24-bit counter wraps, the board's position does not.
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
    # 24 bits end at 16,777,216 counts: five steps of 4,000,000 go over it, and below zero the other way.
    FOR    ${step}    IN RANGE    5
        Execute Command    rig TurnEncoder 1 4000000
        Execute Command    rig TurnEncoder 2 -4000000
        Advance    50
    END
    ${first_after}=    Encoder Position    1
    ${second_after}=    Encoder Position    2
    Should Be Equal As Integers    ${{$first_after - $first}}    20000000
    Should Be Equal As Integers    ${{$second_after - $second}}    -20000000
    ${counter}=    Number    counters Counter 1
    Should Be True    ${counter} < 16777216
    Position Should Follow The Counter    1
    Position Should Follow The Counter    2
